"""The user's choices: settings, presets and manifests."""
