"""What people do with runs: keep them, measure them, map them."""
