"""What the stages write: the arrays of every artifact, of evaluations and of folders, as declarations."""
