"""Who walks: cohorts, the people who ship, the map of outcomes, and the fit of scaling laws."""
