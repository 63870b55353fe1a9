"""``python -m explicitfe``."""

from explicitfe.app.cli.main import entry

entry()
