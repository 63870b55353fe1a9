"""``python -m explicitfe``."""

from explicitfe.cli.main import main

main()
