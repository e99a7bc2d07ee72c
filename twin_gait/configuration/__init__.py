"""Reading and writing of gait tables, experiments and patients as YAML, with validation on reading."""
