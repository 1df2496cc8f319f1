"""The stage `render-vision`."""
