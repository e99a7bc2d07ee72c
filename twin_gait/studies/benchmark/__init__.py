"""Speed: the compiled engine and its peers, timed in turn."""
