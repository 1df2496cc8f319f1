"""Pure functions on arrays: of the project's modules they import only each other and `errors`."""
