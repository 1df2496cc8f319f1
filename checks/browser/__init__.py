"""Tests in a browser, of a make target of their own."""
