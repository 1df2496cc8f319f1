"""Faults, injected on purpose: what becomes of a dataset that is killed, cut short, damaged or changed while it is made."""
