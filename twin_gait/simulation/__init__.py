"""Simulate an experiment, or one joint on its bench; nothing here touches a disk."""
