"""What is faster than what, measured side by side."""
