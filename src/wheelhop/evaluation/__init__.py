"""Error statistics and consistency tests."""
