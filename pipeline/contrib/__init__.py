"""Packages that ship with the project and are found by entry points; nothing in the house imports them."""
