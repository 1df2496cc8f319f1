"""The trade of speed for accuracy: measured on the user's objects, and advice by it. Above the stages, which declare what they trade."""
