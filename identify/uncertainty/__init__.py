"""How well the parameters at a solution are known: covariance, profiles, bootstrap, influence, agreement of logs."""
