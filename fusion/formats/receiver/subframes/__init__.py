"""What satellites send, bit by bit: the navigation messages of GPS, Galileo, BeiDou and GLONASS as ephemerides.

Knows no receiver: each file takes the bits of one kind of message, in the order of the interface documents, and says
where its fields are, so that they can be written as well as read.
"""
