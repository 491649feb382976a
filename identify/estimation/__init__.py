"""From starts to an answer that fits, and how well it is known: covariance, profiles, bootstrap, identifiability."""
