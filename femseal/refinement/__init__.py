"""Coarser and finer versions of a case: error budgets, refinement to a wanted accuracy."""
