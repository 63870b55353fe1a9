"""The command ``explicitfe``: what a person types, what they see while they wait, what a program reads.

``<command>.py``, named after a command, calls the package that does the work, and imports it inside the function, so that
``explicitfe --help`` does not wait for it. ``command.py`` makes arguments and options from signatures and docstrings,
``answer.py`` prints, ``app.py`` puts the commands in order, ``main.py`` is the entry with signals and environment, and
``execute.py`` turns every error into a sentence and an exit code.
"""
