from . import can_link as can_link
from . import journal as journal
from . import page as page
from . import protocol as protocol
from . import session as session
from . import session_records as session_records
