//! A ring of isochronous transfers: each comes back with packets, which are handed out in place, and goes out again.

use super::{Handle, UsbError, check};
use core::cell::RefCell;
use core::ffi::{c_int, c_uint};
use core::ptr::NonNull;
use core::time::Duration;
use libusb1_sys as c;
use libusb1_sys::constants as k;
use std::boxed::Box;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;
use std::vec::Vec;

type Transfer = NonNull<c::libusb_transfer>;
/// Transfers that have come back, and when. A callback puts them here, on the thread that handles events.
type Finished = RefCell<VecDeque<(Transfer, Instant)>>;

/// A microframe, in which one packet may come.
const MICROFRAME: Duration = Duration::from_micros(125);
/// How long cancelled transfers may take to come back.
const PATIENCE: Duration = Duration::from_secs(1);

/// What the host's controller says of a packet that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It was garbled, or the device didn't answer.
    Garbled,
    /// More came than a slot holds.
    Overflow,
    /// Anything else.
    Other,
}

/// A packet of a transfer.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'r> {
    /// As the device sent it, or why not.
    pub bytes: Result<&'r [u8], Fault>,
    /// When it came, as near as the host knows: packets before the end of their transfer.
    pub arrival: Instant,
}

/// The transfers of one endpoint. All memory is taken when it is made.
pub struct Ring {
    transfers: Vec<Transfer>,
    buffer: NonNull<[u8]>,
    finished: NonNull<Finished>,
    packets: usize,
    /// How many transfers are out.
    flying: usize,
    /// The transfer whose packets are handed out, when it came back, and which packet is next.
    current: Option<(Transfer, Instant, usize)>,
    /// Holds the device open; the last to go.
    handle: Arc<Handle>,
}

// SAFETY: its pointers are its own, but for the queue, which callbacks fill on the thread that handles the events of its context; that is
// the thread that holds the ring.
unsafe impl Send for Ring {}

impl Ring {
    /// `transfers` of `packets` slots of `slot` bytes each, for `endpoint`.
    ///
    /// # Errors
    /// There is no memory.
    pub fn new(handle: Arc<Handle>, endpoint: u8, transfers: usize, packets: usize, slot: usize) -> Result<Self, UsbError> {
        let length = packets * slot;
        let buffer = Box::leak(std::vec![0_u8; transfers * length].into_boxed_slice()).into();
        let finished = NonNull::from(Box::leak(Box::new(RefCell::new(VecDeque::with_capacity(transfers)))));
        let mut ring = Self { transfers: Vec::with_capacity(transfers), buffer, finished, packets, flying: 0, current: None, handle };
        for number in 0..transfers {
            // SAFETY: it returns a transfer with room for the descriptors of so many packets, or null.
            let Some(transfer) = NonNull::new(unsafe { c::libusb_alloc_transfer(packets as c_int) }) else {
                return Err(UsbError::new(k::LIBUSB_ERROR_NO_MEM));
            };
            ring.transfers.push(transfer);
            // SAFETY: the transfer is this ring's, with `packets` descriptors behind it; its slots are in the buffer; the queue is there as
            // long as any transfer is.
            unsafe {
                let fields = &mut *transfer.as_ptr();
                fields.dev_handle = ring.handle.handle.as_ptr();
                fields.endpoint = endpoint;
                fields.transfer_type = k::LIBUSB_TRANSFER_TYPE_ISOCHRONOUS;
                fields.callback = finish;
                fields.user_data = finished.as_ptr().cast();
                fields.buffer = buffer.cast::<u8>().as_ptr().add(number * length);
                fields.length = length as c_int;
                fields.num_iso_packets = packets as c_int;
                for packet in 0..packets {
                    (*descriptor(transfer, packet)).length = slot as c_uint;
                }
            }
        }
        Ok(ring)
    }

    /// Sends all transfers out.
    ///
    /// # Errors
    /// The first that the system refuses: no bandwidth, no memory, no device.
    pub fn submit(&mut self) -> Result<(), UsbError> {
        (0..self.transfers.len()).try_for_each(|number| self.transfers.get(number).copied().map_or(Ok(()), |t| self.send(t)))
    }

    fn send(&mut self, transfer: Transfer) -> Result<(), UsbError> {
        // SAFETY: the transfer is whole and not out.
        check(unsafe { c::libusb_submit_transfer(transfer.as_ptr()) })?;
        self.flying += 1;
        Ok(())
    }

    /// Goes on to the next packet, in the order in which they came; false where none has come. A transfer that is used up goes out again.
    ///
    /// # Errors
    /// It can't: the device is gone, as a rule.
    pub fn advance(&mut self) -> Result<bool, UsbError> {
        loop {
            match &mut self.current {
                Some((_, _, next)) if *next < self.packets => {
                    *next += 1;
                    return Ok(true);
                }
                Some((transfer, ..)) => {
                    let transfer = *transfer;
                    self.current = None;
                    self.send(transfer)?;
                }
                None => {
                    // SAFETY: the queue is the ring's; callbacks borrow it only while events are handled.
                    let Some((transfer, at)) = unsafe { self.finished.as_ref() }.borrow_mut().pop_front() else { return Ok(false) };
                    self.flying -= 1;
                    // SAFETY: the transfer has come back.
                    let status = unsafe { (*transfer.as_ptr()).status };
                    // What didn't come back by itself has the packets of the round before.
                    let used_up = if matches!(status, k::LIBUSB_TRANSFER_COMPLETED | k::LIBUSB_TRANSFER_ERROR) { 0 } else { self.packets };
                    self.current = Some((transfer, at, used_up));
                }
            }
        }
    }

    /// The packet that [`Ring::advance`] came to.
    pub fn packet(&self) -> Option<Packet<'_>> {
        let (transfer, at, next) = self.current?;
        let index = next.checked_sub(1)?;
        // SAFETY: the transfer has come back, and has more than `index` packets.
        let (descriptor, buffer) = unsafe { (&*descriptor(transfer, index), (*transfer.as_ptr()).buffer) };
        let bytes = match descriptor.status {
            k::LIBUSB_TRANSFER_COMPLETED => {
                let (slot, length) = (descriptor.length as usize, descriptor.actual_length.min(descriptor.length) as usize);
                // SAFETY: the packet's slot is in the buffer, which nobody writes before the transfer goes out again; that needs the
                // ring for itself.
                Ok(unsafe { core::slice::from_raw_parts(buffer.add(index * slot), length) })
            }
            k::LIBUSB_TRANSFER_ERROR => Err(Fault::Garbled),
            k::LIBUSB_TRANSFER_OVERFLOW => Err(Fault::Overflow),
            _ => Err(Fault::Other),
        };
        let arrival = at.checked_sub(MICROFRAME * (self.packets - next) as u32).unwrap_or(at);
        Some(Packet { bytes, arrival })
    }

    /// Calls back whatever is out; whether all of it came.
    fn cancel(&mut self) -> bool {
        for transfer in &self.transfers {
            // SAFETY: the transfer is alive; one that is not out is not cancelled.
            unsafe { c::libusb_cancel_transfer(transfer.as_ptr()) };
        }
        let begun = Instant::now();
        while self.flying > 0 && begun.elapsed() < PATIENCE {
            if self.handle.context.handle_events(PATIENCE / 10).is_err() {
                break;
            }
            // SAFETY: as in `advance`.
            let finished = unsafe { self.finished.as_ref() }.borrow_mut().drain(..).count();
            self.flying -= finished;
        }
        self.flying == 0
    }
}

impl Drop for Ring {
    fn drop(&mut self) {
        if !self.cancel() {
            // libusb may still write there: better lost than freed.
            core::mem::forget(Arc::clone(&self.handle));
            return;
        }
        // SAFETY: no transfer is out, so that nobody else knows the pointers; the boxes were leaked when the ring was made.
        unsafe {
            for transfer in &self.transfers {
                c::libusb_free_transfer(transfer.as_ptr());
            }
            drop(Box::from_raw(self.buffer.as_ptr()));
            drop(Box::from_raw(self.finished.as_ptr()));
        }
    }
}

/// The descriptor of packet `index`.
///
/// # Safety
/// `transfer` has more than `index` packets.
unsafe fn descriptor(transfer: Transfer, index: usize) -> *mut c::libusb_iso_packet_descriptor {
    // SAFETY: the descriptors stand behind the transfer, as many as it was made for.
    unsafe { (&raw mut (*transfer.as_ptr()).iso_packet_desc).cast::<c::libusb_iso_packet_descriptor>().add(index) }
}

/// A transfer has come back.
extern "system" fn finish(transfer: *mut c::libusb_transfer) {
    // SAFETY: libusb hands over a transfer of a ring, whose queue is there until its transfers are.
    let finished = unsafe { &*(*transfer).user_data.cast::<Finished>() };
    // Nobody borrows it while events are handled; and it has room for every transfer.
    if let (Some(transfer), Ok(mut finished)) = (NonNull::new(transfer), finished.try_borrow_mut()) {
        finished.push_back((transfer, Instant::now()));
    }
}
