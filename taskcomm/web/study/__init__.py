"""The study as data: its design, texts, assignment and folder, and the pages that a participant goes through."""
