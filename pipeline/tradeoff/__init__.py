"""Measure the trade of speed for accuracy on the user's objects, and advise from it. Stages declare their trades."""
