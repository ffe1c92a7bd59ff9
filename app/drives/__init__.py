"""Drives: upload -> row and job -> worker -> result, and what a drive yielded."""
