//! libusb behind safe types: the only unsafe of the driver.
//!
//! A context's events are handled by whoever holds one of its [`Ring`]s, on one thread at a time; only there are callbacks called.
#![allow(unsafe_code)] // It speaks to a C library.

mod ring;

pub use ring::{Fault, Packet, Ring};

use core::ffi::{CStr, c_int};
use core::ptr::{self, NonNull};
use core::time::Duration;
use libusb1_sys as c;
use libusb1_sys::constants as k;
use std::io;
use std::string::String;
use std::sync::Arc;
use std::vec::Vec;

/// What libusb says, and what the system said last.
#[derive(Debug)]
pub struct UsbError {
    code: c_int,
    system: io::Error,
}

impl UsbError {
    fn new(code: c_int) -> Self {
        Self { code, system: io::Error::last_os_error() }
    }

    /// The device is gone.
    pub fn is_gone(&self) -> bool {
        self.code == k::LIBUSB_ERROR_NO_DEVICE
    }

    /// Permission is denied.
    pub fn is_denied(&self) -> bool {
        self.code == k::LIBUSB_ERROR_ACCESS
    }

    /// Another program, or a driver of the kernel, holds it.
    pub fn is_busy(&self) -> bool {
        self.code == k::LIBUSB_ERROR_BUSY
    }

    /// The bus has no room for the transfers.
    pub fn is_out_of_bandwidth(&self) -> bool {
        self.code == k::LIBUSB_ERROR_IO && self.system.kind() == io::ErrorKind::StorageFull
    }

    /// The system has no memory for the transfers.
    pub fn is_out_of_memory(&self) -> bool {
        self.code == k::LIBUSB_ERROR_NO_MEM || (self.code == k::LIBUSB_ERROR_IO && self.system.kind() == io::ErrorKind::OutOfMemory)
    }
}

impl core::fmt::Display for UsbError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        // SAFETY: libusb_error_name returns a string that is there for ever, whatever the code.
        let name = unsafe { CStr::from_ptr(c::libusb_error_name(self.code)) }.to_string_lossy();
        match self.code {
            k::LIBUSB_ERROR_IO | k::LIBUSB_ERROR_OTHER => write!(f, "{name}, {}", self.system),
            _ => f.write_str(&name),
        }
    }
}

/// A count, or an error.
fn check(code: c_int) -> Result<usize, UsbError> {
    usize::try_from(code).map_err(|_| UsbError::new(code))
}

/// A connection to libusb. It knows the devices that were there when it was made.
pub struct Context(NonNull<c::libusb_context>);

// SAFETY: libusb locks a context's state itself; its documentation allows its use from any thread.
unsafe impl Send for Context {}
// SAFETY: as above.
unsafe impl Sync for Context {}

impl Context {
    /// A new one.
    ///
    /// # Errors
    /// There is no bus, or libusb can't use it.
    pub fn new() -> Result<Arc<Self>, UsbError> {
        let mut context = ptr::null_mut();
        // SAFETY: it writes a context to the pointer, or returns an error.
        check(unsafe { c::libusb_init(&raw mut context) })?;
        NonNull::new(context).map(|context| Arc::new(Self(context))).ok_or_else(|| UsbError::new(k::LIBUSB_ERROR_OTHER))
    }

    /// The devices that are attached.
    ///
    /// # Errors
    /// libusb has no memory.
    pub fn devices(self: &Arc<Self>) -> Result<Vec<Device>, UsbError> {
        let mut list = ptr::null();
        // SAFETY: the context is alive; it writes an array of that many devices to the pointer, or returns an error.
        let count = unsafe { c::libusb_get_device_list(self.0.as_ptr(), &raw mut list) };
        let count = check(count.try_into().unwrap_or(k::LIBUSB_ERROR_OTHER))?;
        // SAFETY: the list has `count` devices, each of which the caller owns one reference.
        let devices = unsafe { core::slice::from_raw_parts(list, count) };
        let devices = devices.iter().filter_map(|device| NonNull::new(*device));
        let devices = devices.map(|device| Device { device, context: Arc::clone(self) }).collect();
        // SAFETY: the list goes, the references stay.
        unsafe { c::libusb_free_device_list(list, 0) };
        Ok(devices)
    }

    /// Waits at most `patience` for something to happen, and lets libusb handle it.
    ///
    /// # Errors
    /// libusb can't.
    pub fn handle_events(&self, patience: Duration) -> Result<(), UsbError> {
        #[allow(clippy::cast_lossless)] // They differ from system to system.
        let patience = libc::timeval { tv_sec: patience.as_secs() as libc::time_t, tv_usec: patience.subsec_micros() as libc::suseconds_t };
        // SAFETY: the context is alive; callbacks are called on this thread, by which no queue is borrowed.
        let code = unsafe { c::libusb_handle_events_timeout_completed(self.0.as_ptr(), &raw const patience, ptr::null_mut()) };
        // A signal is whatever program's business.
        if code == k::LIBUSB_ERROR_INTERRUPTED { Ok(()) } else { check(code).map(drop) }
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: devices and handles hold the context, so that none is left.
        unsafe { c::libusb_exit(self.0.as_ptr()) }
    }
}

/// A device that is, or was, attached.
pub struct Device {
    device: NonNull<c::libusb_device>,
    context: Arc<Context>,
}

// SAFETY: libusb locks a device's state itself.
unsafe impl Send for Device {}

/// What a device tells before it is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // As in the USB specification.
pub struct Descriptor {
    pub vendor: u16,
    pub product: u16,
    pub bcd_device: u16,
    pub serial_index: u8,
}

impl Device {
    /// Its descriptor.
    ///
    /// # Errors
    /// libusb doesn't have it.
    pub fn descriptor(&self) -> Result<Descriptor, UsbError> {
        let mut descriptor = core::mem::MaybeUninit::<c::libusb_device_descriptor>::zeroed();
        // SAFETY: the device is alive, and the descriptor is plain numbers that it overwrites.
        check(unsafe { c::libusb_get_device_descriptor(self.device.as_ptr(), descriptor.as_mut_ptr()) })?;
        // SAFETY: zeros are a descriptor already.
        let descriptor = unsafe { descriptor.assume_init() };
        Ok(Descriptor {
            vendor: descriptor.idVendor,
            product: descriptor.idProduct,
            bcd_device: descriptor.bcdDevice,
            serial_index: descriptor.iSerialNumber,
        })
    }

    /// Its bus and its address there.
    pub fn address(&self) -> (u8, u8) {
        // SAFETY: the device is alive.
        unsafe { (c::libusb_get_bus_number(self.device.as_ptr()), c::libusb_get_device_address(self.device.as_ptr())) }
    }

    /// The ports that lead to it, from the root hub on.
    pub fn ports(&self) -> Vec<u8> {
        // USB allows 7.
        let mut ports = [0; 8];
        // SAFETY: the device is alive, and the array is as long as is said.
        let count = unsafe { c::libusb_get_port_numbers(self.device.as_ptr(), ports.as_mut_ptr(), ports.len() as c_int) };
        ports.get(..usize::try_from(count).unwrap_or(0)).unwrap_or_default().to_vec()
    }

    /// Whether it runs slower than USB 2 can (12 or 1.5 Mbit/s).
    pub fn is_slow(&self) -> bool {
        // SAFETY: the device is alive.
        let speed = unsafe { c::libusb_get_device_speed(self.device.as_ptr()) };
        speed == k::LIBUSB_SPEED_LOW || speed == k::LIBUSB_SPEED_FULL
    }

    /// Opens it.
    ///
    /// # Errors
    /// It is gone, or permission is denied.
    pub fn open(&self) -> Result<Handle, UsbError> {
        let mut handle = ptr::null_mut();
        // SAFETY: the device is alive; it writes a handle to the pointer, or returns an error.
        check(unsafe { c::libusb_open(self.device.as_ptr(), &raw mut handle) })?;
        let handle = NonNull::new(handle).ok_or_else(|| UsbError::new(k::LIBUSB_ERROR_OTHER))?;
        Ok(Handle { handle, context: Arc::clone(&self.context) })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the reference is its own.
        unsafe { c::libusb_unref_device(self.device.as_ptr()) }
    }
}

/// An open device.
pub struct Handle {
    handle: NonNull<c::libusb_device_handle>,
    context: Arc<Context>,
}

// SAFETY: libusb locks a handle's state itself.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

/// The one interface of a Kinect's camera.
const INTERFACE: c_int = 0;

impl Handle {
    /// The context of its device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Takes the camera's interface, from a driver of the kernel as well, which gets it back when the handle is dropped.
    ///
    /// # Errors
    /// Another program has it, or the device is gone.
    pub fn claim(&self, alternate_setting: u8) -> Result<(), UsbError> {
        let handle = self.handle.as_ptr();
        // SAFETY: the handle is alive. Where the system has no such drivers, it is an error without consequence.
        unsafe { c::libusb_set_auto_detach_kernel_driver(handle, 1) };
        // SAFETY: the handle is alive.
        check(unsafe { c::libusb_claim_interface(handle, INTERFACE) })?;
        if alternate_setting != 0 {
            // SAFETY: the handle is alive.
            check(unsafe { c::libusb_set_interface_alt_setting(handle, INTERFACE, alternate_setting.into()) })?;
        }
        Ok(())
    }

    /// The string of this index, its characters beyond ASCII as `?`.
    ///
    /// # Errors
    /// The device doesn't tell.
    pub fn string(&self, index: u8) -> Result<String, UsbError> {
        let mut text = [0; 256];
        // SAFETY: the handle is alive, and the array is as long as is said.
        let length =
            check(unsafe { c::libusb_get_string_descriptor_ascii(self.handle.as_ptr(), index, text.as_mut_ptr(), text.len() as c_int) })?;
        Ok(String::from_utf8_lossy(text.get(..length).unwrap_or_default()).into_owned())
    }

    /// A control transfer to the device: vendor request 0.
    ///
    /// # Errors
    /// It failed, or took longer than `patience`.
    pub fn control_out(&self, bytes: &[u8], patience: Duration) -> Result<(), UsbError> {
        // SAFETY: the bytes are only read, although the pointer doesn't say so, and are as many as is said.
        check(unsafe { self.control(0x40, bytes.as_ptr().cast_mut(), bytes.len(), patience) }).map(drop)
    }

    /// A control transfer from the device: vendor request 0. How many bytes came.
    ///
    /// # Errors
    /// It failed, or took longer than `patience`.
    pub fn control_in(&self, bytes: &mut [u8], patience: Duration) -> Result<usize, UsbError> {
        // SAFETY: the bytes are the caller's to be written, and are as many as is said.
        check(unsafe { self.control(0xc0, bytes.as_mut_ptr(), bytes.len(), patience) })
    }

    /// # Safety
    /// `bytes` points at `length` bytes, which may be written where the request type says so.
    unsafe fn control(&self, request_type: u8, bytes: *mut u8, length: usize, patience: Duration) -> c_int {
        let (length, patience) = (length as u16, patience.as_millis() as u32);
        // SAFETY: the handle is alive; the rest is the caller's promise.
        unsafe { c::libusb_control_transfer(self.handle.as_ptr(), request_type, 0, 0, 0, bytes, length, patience) }
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the handle is alive; what was not claimed is not released. Rings hold the handle, so that none is at work.
        unsafe {
            c::libusb_release_interface(self.handle.as_ptr(), INTERFACE);
            c::libusb_close(self.handle.as_ptr());
        }
    }
}
