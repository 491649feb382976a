"""Records whose cycles differ: every slip filtered, strength and level of every stick integrated out."""
