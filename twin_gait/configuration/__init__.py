"""Reading and writing of gait tables, experiments and people as YAML, with validation on reading."""
