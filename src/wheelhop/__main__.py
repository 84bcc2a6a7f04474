"""`python -m wheelhop`."""

from wheelhop.cli import main

main()
