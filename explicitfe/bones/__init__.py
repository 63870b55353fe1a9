"""Rigid surfaces that the tongue rests on: triangle surfaces, how far a point is from them, and how a bone moves."""
