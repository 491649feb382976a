"""The document of result.json, and the curves behind the report."""
