"""The closed-loop tree where more than a press may be observed: every value of every discrete channel."""
