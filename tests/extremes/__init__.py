"""What kernels do at the ends of their ranges: sizes, places, shapes and values no good mesh or image has."""
