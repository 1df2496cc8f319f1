"""The stage `train-gcn`."""
