"""Tyre stiffness by recursive maximum likelihood: what it reaches, against the bound."""
