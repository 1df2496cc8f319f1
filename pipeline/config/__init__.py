"""What a user chooses: settings, presets, manifests, and the description files of hands, sensors and scenes."""
