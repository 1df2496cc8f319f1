"""Learning: what training, evaluating and using models stand on."""
