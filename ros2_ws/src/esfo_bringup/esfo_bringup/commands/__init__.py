"""One module per sub-command of `esfo`: `add_to` declares its arguments, `execute` does its work."""
