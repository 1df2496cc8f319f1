"""Fault injection: datasets survive kills, interruptions, damage and changes while they are made."""
