"""Export of logs to the formats of other programs."""
