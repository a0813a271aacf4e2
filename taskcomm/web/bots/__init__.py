"""Programs that take the place of people in a study: a teacher, an operator, an annotator.

They speak over the WebSocket, as browsers do, and know nothing that a browser is not told.
"""

from taskcomm.web.bots.annotator import label_presses as label_presses
from taskcomm.web.bots.line import Line as Line
from taskcomm.web.bots.line import LineError as LineError
from taskcomm.web.bots.operator import OperatorBot as OperatorBot
from taskcomm.web.bots.teacher import TeacherBot as TeacherBot
