"""The command line: `vt-pipeline run STAGE`, what inspects a data directory, and what uses trained models."""

from pipeline.cli.app import app

__all__ = ["app"]
