"""The stage `train-unet`."""
