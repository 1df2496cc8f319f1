"""The pictures of `docs/how-it-works`, one per stage, all of one object of a dataset that went through every stage."""
