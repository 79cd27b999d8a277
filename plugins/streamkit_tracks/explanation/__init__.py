"""Explains where a track came from, by the file that tracksink wrote.

`command` is `streamkit explain`: it reads the moments of one track. `history` sums them up, and
`wording` puts them in words.
"""
