"""What a tongue did, as numbers from its result file: docs/measures.md defines them."""
