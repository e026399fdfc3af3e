"""Taking the messages of a fast topic apart from all others."""
