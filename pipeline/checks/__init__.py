"""Checks of description files, manifests, hands and sensors."""
