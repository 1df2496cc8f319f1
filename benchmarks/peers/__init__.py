"""Side by side with what users would pick instead: `make bench-peers`, or `python -m benchmarks.peers --data DIR`."""
