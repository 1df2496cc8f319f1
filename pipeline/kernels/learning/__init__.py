"""Networks, losses and metrics: from readings and images to charts and their vertices."""
