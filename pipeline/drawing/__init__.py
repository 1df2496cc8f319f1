"""Pictures that several rooms need."""
