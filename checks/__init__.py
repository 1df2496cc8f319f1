"""Long suites, each run by a make target of its own; they use the tests' small datasets and slow twins."""
