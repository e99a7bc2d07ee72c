"""What a run leaves on the disk: its directory, its summary, and how it is read again."""
