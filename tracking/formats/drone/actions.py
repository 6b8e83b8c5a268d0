"""The actions that people are labelled with in the drone data sets (thesis Tables 5.1 and 5.2)."""

from __future__ import annotations

HANDSHAKING, HUGGING = "Handshaking", "Hugging"
READING, DRINKING, PUSHING, CARRYING, CALLING = "Reading", "Drinking", "Pushing/Pulling", "Carrying", "Calling"
RUNNING, WALKING, LYING, SITTING, STANDING = "Running", "Walking", "Lying", "Sitting", "Standing"

# In the order of thesis Table 5.1: between people, with objects, and neither; at most one of the last kind at a time.
WITH_PEOPLE = (HANDSHAKING, HUGGING)
WITH_OBJECTS = (READING, DRINKING, PUSHING, CARRYING, CALLING)
POSTURES = (RUNNING, WALKING, LYING, SITTING, STANDING)
OKUTAMA_ACTIONS = WITH_PEOPLE + WITH_OBJECTS + POSTURES
