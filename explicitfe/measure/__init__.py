"""What a tongue did, as numbers from its result file: docs/reference/measures.md defines them."""
