"""Coarser and finer versions of a case: error budgets, speed against error, refinement to a wanted accuracy."""
