"""States of the pages: ``tests/app/web/test_states.py`` tries each on desk and phone, light and dark, in each language.

``table`` says what a state is; the modules beside it hold the states themselves, by page; ``services`` makes what they
are looked at in; ``rules`` is what every one of them keeps to.
"""
