"""A robot hand: its model, where its parts are, what they reach and what they run into."""
