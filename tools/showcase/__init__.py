"""Pictures to show: grasps rendered by Blender, beside our own renderer."""
