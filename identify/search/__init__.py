"""From starts to an answer that passes the gate, or to the best reason why none does."""
