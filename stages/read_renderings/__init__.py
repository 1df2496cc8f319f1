"""The stage `read-renderings`."""
