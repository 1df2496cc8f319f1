"""What each stage left out, one module per stage, each with a function `explain` that yields counts."""
