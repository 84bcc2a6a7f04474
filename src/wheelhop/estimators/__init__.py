"""Estimators a user picks, built from filtering and vehicle."""
