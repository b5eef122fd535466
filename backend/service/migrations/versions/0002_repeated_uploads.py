"""An Idempotency-Key may stand for a stored thing, too."""

from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Call what a key made by a name that fits both."""
    op.execute("ALTER TABLE repeat RENAME COLUMN job TO made")


def downgrade() -> None:
    """Keys of things go: no job stands behind them."""
    op.execute("DELETE FROM repeat WHERE made NOT IN (SELECT id FROM job)")
    op.execute("ALTER TABLE repeat RENAME COLUMN made TO job")
