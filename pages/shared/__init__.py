"""What the pages have in common; nothing in here is a page."""
