"""Tests of specimens as the loop sees them."""
