"""Pictures of results, surfaces and load paths."""
