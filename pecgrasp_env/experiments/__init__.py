"""Measurements of their own: does training transfer, do the published figures come true?"""
