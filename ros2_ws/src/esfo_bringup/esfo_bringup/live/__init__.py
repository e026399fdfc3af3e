"""A live run: replay, front-end and back-end in a process each, and a node that collects what they publish."""
