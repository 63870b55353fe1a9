"""``python -m explicitfe``."""

from explicitfe.cli.main import entry

entry()
