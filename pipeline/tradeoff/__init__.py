"""Which settings to choose, and what a run left out: above the stages, which do not know it."""
