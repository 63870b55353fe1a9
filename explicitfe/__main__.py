"""``python -m explicitfe``."""

from explicitfe.cli import main

main()
