"""Coarser and finer versions of a case: refinement to a wanted accuracy."""
