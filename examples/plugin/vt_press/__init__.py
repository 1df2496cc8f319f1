"""An example of a package that brings a sensor and a stage to vt-pipeline."""
