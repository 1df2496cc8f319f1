"""Procedural objects for manifests that need no download: the paper's four classes and nine others."""
