"""Monte Carlo campaigns."""
