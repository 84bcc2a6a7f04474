"""Which tyre went soft, while cornering: Solmaz's switched models and what goes beyond them."""
