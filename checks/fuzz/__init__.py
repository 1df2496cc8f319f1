"""Fuzzing of everything that reads files of users or strangers: mutated files give clear errors, quickly and in little memory."""
