"""The commands of `taskcomm`, one a module, each loaded when it is run. Only `taskcomm.cli` uses them."""
