"""At the bench: what a rig is, from short records of it, and which test to make next, before it is made."""
