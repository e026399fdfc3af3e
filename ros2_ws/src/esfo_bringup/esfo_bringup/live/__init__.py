"""A live run: three nodes in processes of their own, and one that collects what they publish."""
