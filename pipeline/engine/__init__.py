"""What every stage has in common: plans, keys, runs and executors."""
