"""`python -m pipeline` is `vt-pipeline`."""

from pipeline.cli import app

app()
