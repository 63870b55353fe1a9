"""The command ``explicitfe``: what a person types, what they see while they wait, what a program reads.

``<command>.py``, named after a command, reads its options and calls the room that does the work; it imports that room inside the
function, so that ``explicitfe --help`` waits for nobody. ``options.py`` holds what several commands ask for, ``answer.py`` what
they print, ``app.py`` puts the commands in order, ``main.py`` is the entry: signals and environment, ``execute.py`` says what a
line comes to.
"""
