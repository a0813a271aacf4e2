"""A study as data: its design, texts, assignment and folder, and the pages that participants go through."""
