"""What lasts in the composed model: the stick-slip orbit, steady sliding, and how both move with its quantities."""
