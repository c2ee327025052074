"""Pictures of everything that can be shown; matplotlib is imported here and nowhere below."""
