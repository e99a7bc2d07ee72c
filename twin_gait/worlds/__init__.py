"""Worlds of the leg model (bench leg, treadmill, floor), and the test bench of a single joint."""
